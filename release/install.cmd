@echo off
rem Installs trueflank from this folder, without a network: install.cmd [FOLDER]   (default: %LOCALAPPDATA%\trueflank)
rem Each version gets a folder of its own, FOLDER\trueflank.cmd starts the one installed last. Runs, site files, approvals
rem and the audit trail are never touched. To go back, run the installer of the older bundle again: it
rem only chooses what is there. To mend a version, delete its folder first.
setlocal
set "here=%~dp0"
set "there=%LOCALAPPDATA%\trueflank"
if not "%~1"=="" set "there=%~f1"
set /p version=<"%here%VERSION"
py -3.11 -c "import venv" >nul 2>&1
if errorlevel 1 (
    echo install: this bundle needs Python 3.11 with its launcher py; install it first 1>&2
    exit /b 2
)
rem Windows reads no list of sums by itself; the Python that was just found compares each file with SHA256SUMS.
py -3.11 -c "import hashlib, pathlib, sys; here = pathlib.Path(sys.argv[1]); told = [line.split('  ', 1) for line in (here / 'SHA256SUMS').read_text('utf-8').splitlines()]; sys.exit(not told or any(hashlib.sha256((here / name).read_bytes()).hexdigest() != digest for digest, name in told))" "%here%." >nul 2>&1
if errorlevel 1 (
    echo install: a file of the bundle is not as it was made; nothing was installed. Copy the archive again 1>&2
    exit /b 2
)
rem A version stands whole or not at all: it is made beside, and carries its lock when it is whole. One that is there already
rem is only chosen again. No jumps: cmd misses labels in a file with the line ends of other systems.
set "new=%there%\versions\%version%"
set "whole=yes"
fc /b "%here%requirements.lock" "%new%\requirements.lock" >nul 2>&1 || set "whole="
if not defined whole (
    if exist "%new%.new" rmdir /s /q "%new%.new"
    py -3.11 -m venv "%new%.new" || exit /b 2
    "%new%.new\Scripts\python" -m pip install --quiet --disable-pip-version-check --no-index --no-cache-dir --find-links "%here%wheels" --require-hashes -r "%here%requirements.lock" || (
        echo install: the new version could not be made; the version of before is as it was 1>&2
        exit /b 2
    )
    copy /y "%here%requirements.lock" "%new%.new\requirements.lock" >nul || exit /b 2
    if exist "%new%.old" if exist "%new%" rmdir /s /q "%new%.old"
    if exist "%new%" (
        move "%new%" "%new%.old" >nul || (
            echo install: this version is in use; end every trueflank and install again 1>&2
            exit /b 2
        )
    )
    move "%new%.new" "%new%" >nul || (
        if exist "%new%.old" move "%new%.old" "%new%" >nul
        echo install: the new version could not be put in its place; the version of before is as it was 1>&2
        exit /b 2
    )
    if exist "%new%.old" rmdir /s /q "%new%.old"
)
>"%there%\trueflank.cmd.new" echo @"%new%\Scripts\python" -m gateway.cli %%*
move /y "%there%\trueflank.cmd.new" "%there%\trueflank.cmd" >nul || exit /b 2
echo trueflank %version% is installed. Start it: "%there%\trueflank.cmd" --help
